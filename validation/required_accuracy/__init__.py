"""True errors of runs that are refined until an accuracy is reached."""

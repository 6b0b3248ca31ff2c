"""Range of validity of the strains in a floating frame."""

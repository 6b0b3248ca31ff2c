"""floating_frame."""

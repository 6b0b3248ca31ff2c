"""What each formulation of a beam converges to, and how fast."""

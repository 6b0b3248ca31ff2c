"""Coverage, tightness and cost of certificates on mechanisms with known solutions."""

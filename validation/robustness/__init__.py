"""Bad inputs, random mechanisms and faults: what is right of each, and what happened."""

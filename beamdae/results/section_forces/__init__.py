"""section_forces."""

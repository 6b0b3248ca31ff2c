"""model_files."""

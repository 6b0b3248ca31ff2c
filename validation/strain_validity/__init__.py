"""Range of validity of moderate strains: cantilevers in floating frames and their references."""

"""Does rtol mean what it says? Cases, references and the table behind the defaults."""

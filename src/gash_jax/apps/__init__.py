"""Everything with a user: command line, pictures, tables."""

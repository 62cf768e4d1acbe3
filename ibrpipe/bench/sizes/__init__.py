"""How time grows with size, and the paper's own table."""

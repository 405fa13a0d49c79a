"""A flight as one page: pictures and a summary of its record."""

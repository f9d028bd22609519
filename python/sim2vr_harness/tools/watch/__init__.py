"""A look at play, live in the browser."""

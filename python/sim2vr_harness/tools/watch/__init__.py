"""A look at play: live in the browser, or as a recording for Rerun's viewer."""

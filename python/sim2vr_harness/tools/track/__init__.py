"""Motion tracking of people's recorded hands with a simulated body, to estimate muscle loads."""

"""Recorded hands of people, followed by a simulated body: what their movement asks of muscles."""

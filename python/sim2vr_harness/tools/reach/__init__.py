"""How far a user reaches, and which targets lie within."""

"""Thins a stored repertoire to what a robot needs, with a card that tells where it comes from."""

"""Asks a repertoire that is being served for behaviors, from a shell."""

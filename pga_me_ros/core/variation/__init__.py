"""Variation operators: how offspring are made from parents and from what was learned (Alg. 5)."""

"""Archives of elites: cells, elites, metrics, novelty, pictures."""

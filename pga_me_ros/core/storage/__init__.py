"""Files of a run: the repertoire, metrics, checkpoints, and how they are written safely."""

"""Files of a run: repertoire, metrics and checkpoints, and how they are written safely."""

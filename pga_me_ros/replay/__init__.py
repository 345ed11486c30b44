"""Recorded experience, put to use: trains critics, restores a run's own, or is published again."""

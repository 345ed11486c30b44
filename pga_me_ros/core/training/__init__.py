"""Trainings of a run: carried out in the background, durable, and repeatable after a crash."""

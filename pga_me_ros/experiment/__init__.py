"""Runs a matrix of systems, tasks and seeds: each cell is a run of the graph in its own processes."""

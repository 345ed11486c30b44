"""The parts of the adapter: its memory, what it asks the repertoire, and its messages."""

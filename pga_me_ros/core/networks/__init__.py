"""Multi-layer perceptrons: controllers and the shapes of all networks, with only NumPy."""

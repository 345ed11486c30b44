"""Multi-layer perceptrons: controllers and the shapes of all networks, NumPy alone."""

"""Fast, reproducible gradients of small networks: networks, Adam, policy gradient, threads."""

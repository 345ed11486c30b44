"""Gradients of small networks, fast and with the same bits every time: networks, Adam, policy gradient, threads."""

"""QD-RL (Cideron et al. 2020) with a MAP-Elites archive."""

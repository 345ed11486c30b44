"""MAP-Elites-ES (Colas et al. 2020): MAP-Elites by steps of an evolution strategy."""

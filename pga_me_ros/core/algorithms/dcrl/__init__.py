"""DCRL-MAP-Elites: one actor and critics for all descriptors, learned from the whole archive (Faldor et al. 2025)."""

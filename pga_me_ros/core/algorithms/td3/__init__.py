"""TD3 with an archive that collects behaviors passively."""

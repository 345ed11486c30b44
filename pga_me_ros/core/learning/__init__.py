"""Critic training (Alg. 4): replay buffer, critics, targets, and the learner that returns a snapshot per generation."""

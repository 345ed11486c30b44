"""Critic training (Alg. 4): replay buffer, critics, targets, and the learner that gives a snapshot per generation."""

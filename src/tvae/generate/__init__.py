"""Behaviour from a model: imagined, or acted in an environment."""

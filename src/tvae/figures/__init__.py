"""Pictures: latent space, trajectories, training curves. Every function takes data and returns a figure."""

"""Pictures: latent space, trajectories, training, the paper's figures. Every function takes data and gives a figure."""

"""The Modified Mixture Particle Filter and its motion models; a library on its own."""

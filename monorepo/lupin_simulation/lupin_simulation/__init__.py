"""Simulations of the SDF world, a camera, and a navigator with a robot, and a demo that runs them."""

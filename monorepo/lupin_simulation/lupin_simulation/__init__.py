"""All that stands for a real thing: the SDF world, a camera, a navigator with a robot, and a demo."""

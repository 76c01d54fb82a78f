"""The simulated accumulator: physics, virtual master, ports that look like the real thing."""

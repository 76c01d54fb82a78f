"""What a battery reads into frames of its DBC: the way back of `battery_decoder`, for the simulated accumulator."""

"""The drill: bad days drawn at random, what the crew and the product made of them, and the score."""

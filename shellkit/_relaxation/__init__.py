"""The forward pass: from an energy to its minimum, and the programs that a kind of problem shares."""

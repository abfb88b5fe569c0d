"""Fields on a shape: what it is strained and stressed by, face by face, and where its directors went."""

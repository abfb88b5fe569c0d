"""Loads, and what a shell rests on or runs into."""

"""The papers behind the parts, and how those behind a whole problem are gathered."""

"""Files: written whole or not at all, locked, and checked against a schema where they are read."""

"""Files: write them whole or not at all, lock their folder, and check them against a schema when reading."""

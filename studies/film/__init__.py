"""Films of cradles, rendered by a model of a camera, and how well they are measured."""

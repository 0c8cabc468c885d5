"""How well the clicks of a cradle are found in sound, and what they say of the cradle."""

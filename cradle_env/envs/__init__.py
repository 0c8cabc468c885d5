"""The Gymnasium environments: one cradle, many at once, and whole experiments as one step."""

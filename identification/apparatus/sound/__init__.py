"""Sound → impacts: the clicks of a recording, their instants and amplitudes."""

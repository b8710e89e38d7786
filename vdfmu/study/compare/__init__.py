"""Control laws compared: tuned alike, on arms, motions and mismatches, as one table."""

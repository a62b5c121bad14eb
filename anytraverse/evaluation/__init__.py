"""How good a perceiver is: labelled drives, and the scores on them."""

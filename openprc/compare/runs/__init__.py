"""One experiment on several producers: what is asked for, run and known."""

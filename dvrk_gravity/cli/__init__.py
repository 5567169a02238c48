"""One module a verb: argument parsing and printing, no mathematics."""

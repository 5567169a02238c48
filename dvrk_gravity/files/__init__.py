"""Files read and written: strict YAML and JSON, text written whole or not at all."""

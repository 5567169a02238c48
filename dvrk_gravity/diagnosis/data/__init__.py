"""What a diagnosis starts from: the motion, and by how much model or reference may be off."""

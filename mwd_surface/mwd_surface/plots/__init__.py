"""Pictures of a recording, in constant memory."""

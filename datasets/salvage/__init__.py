"""Recovery of messages from damaged bags without their index."""

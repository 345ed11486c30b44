"""What a run keeps in its folder: settings, experience, critics, and where it starts from."""

"""What a run keeps in its folder: settings, experience, critics, and the controllers it starts from."""

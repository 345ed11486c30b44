"""What the archive manager serves: repertoire services and pictures of the archive."""

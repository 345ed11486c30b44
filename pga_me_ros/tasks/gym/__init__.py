"""Tasks from Gymnasium: any registered environment with Box observations and actions."""

"""A page in the browser that shows a repertoire: its map, its gaits as they move, and what is known of them."""

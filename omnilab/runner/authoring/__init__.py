"""For those who write plugins: components made of templates."""

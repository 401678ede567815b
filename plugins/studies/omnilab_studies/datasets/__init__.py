"""Images for other programs: data sets on disk, views from chosen poses."""

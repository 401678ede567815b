"""Images for other programs: data sets on disk, pictures from chosen poses."""

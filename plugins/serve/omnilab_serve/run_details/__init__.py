"""What a run's folder holds, for who looks at one run: its files, its log, its queries, its versions."""

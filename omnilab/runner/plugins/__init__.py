"""What plugins ship beside their code: recipes and worlds, in folders that they register."""

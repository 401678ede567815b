"""The written pages of the documentation and their pictures: `omnilab docs` builds the site of them."""

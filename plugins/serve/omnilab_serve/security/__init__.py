"""What keeps strangers out: hosts, tokens, forged requests, content policies, bounds."""

from omnilab_serve.security.access import Access as Access
from omnilab_serve.security.protection import protect as protect

"""What is to be run: submissions, their order, and the processes that run them."""

from omnilab_serve.queue.run_queue import RunQueue as RunQueue

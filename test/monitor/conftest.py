"""The bench of the node tests, built anew and torn down for each."""

import pytest


@pytest.fixture
def make_bench(context, executor):
    """Give a factory of benches; arguments as of `support.Bench`."""
    from support import Bench
    benches = []

    def make(*args, **options):
        benches.append(Bench(context, executor, *args, **options))
        return benches[-1]

    yield make
    for bench in reversed(benches):
        bench.close()


@pytest.fixture
def bench(make_bench):
    """Give a bench with the default arm, which does not become stale."""
    return make_bench()

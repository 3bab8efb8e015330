"""What `make run` compiles before the demo."""

from estimator.thermostat import closed_loop
from estimator.verification import summaries
from replay.lab.kernels import main


def test_forecasts_of_the_demo_find_everything_compiled():
    main()
    assert closed_loop._run.signatures
    assert summaries._summarise.signatures

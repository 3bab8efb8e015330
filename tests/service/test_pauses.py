from service.pauses import GrowingPause


def test_pauses_double_up_to_the_longest_and_begin_anew_after_a_success():
    pause, seen = GrowingPause(1.0, 6.0), []
    for _ in range(5):
        seen.append(pause.seconds)
        pause.grow()
    assert seen == [1.0, 2.0, 4.0, 6.0, 6.0]

    pause.reset()
    assert pause.seconds == 1.0

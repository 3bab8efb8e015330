import os

from service.web.server.followed import FollowedFiles


def test_a_file_that_comes_changes_and_goes_is_noticed_until_it_is_looked_at(tmp_path):
    path = tmp_path / "keys.json"
    files = FollowedFiles(path)
    assert not files.changed()

    changes = [
        lambda: path.write_text("one"),
        lambda: path.write_text("longer"),
        lambda: os.utime(path, ns=(0, 0)),
        lambda: path.chmod(0o600 if path.stat().st_mode & 0o077 else 0o640),
        path.unlink,
    ]
    for change in changes:
        change()
        assert files.changed()
        assert files.changed(), "asking is not looking"
        files.look()
        assert not files.changed()


def test_one_of_several_files_is_enough(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    first.write_text("a")
    files = FollowedFiles(first, second)

    second.write_text("b")

    assert files.changed()

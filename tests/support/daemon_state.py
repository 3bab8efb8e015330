"""What a daemon leaves in its state folder."""

from collections.abc import Iterable

from service.config.fitting import fingerprint, make_worker
from service.config.kept import keep_configuration
from service.config.site import Config
from service.records.sample import Sample
from service.records.skill import Skill
from service.store.checkpoint import CheckpointStore
from service.store.journal import Journal
from service.store.store import CHECKPOINTS, JOURNAL
from service.zone import snapshot
from service.zone.worker import ZoneWorker


def leave_state(config: Config, samples: Iterable[Sample], kept: int) -> tuple[ZoneWorker, Skill | None]:
    """Leave what a daemon has of the only zone of `config` after `samples`, with a checkpoint after the one at place
    `kept`; the zone's worker, and its skill at the checkpoint."""
    (zone,), folder, skill = config.zones, config.site.state_dir, None
    worker, journal, mark = make_worker(zone), Journal.open(folder / JOURNAL), fingerprint(zone)
    journal.claim(zone.id, mark)
    for place, sample in enumerate(samples):
        journal.append_all([(zone.id, sample)])
        journal.record(zone.id, worker.step(sample))
        if place == kept:
            CheckpointStore(folder / CHECKPOINTS).save(zone.id, snapshot.take(worker, mark, zone.estimator))
            skill = worker.skill()
    journal.close()
    keep_configuration(config)
    return worker, skill

"""What a shard keeps for its gateways."""

import asyncio

from support.fake_zones import make_update, running

from service.fleet.shards.outbox import Outbox
from service.publish.sinks import Announcement, Occasion, Reports


def test_a_gateway_is_told_of_a_zone_what_is_new_to_it():
    zone = running("living")
    state = zone.now()._replace(update=make_update(2))

    async def told():
        outbox = Outbox("htwg")
        outbox.zones = {"living": zone}
        outbox.publish(Announcement("htwg", "living", state, Occasion.UPDATE, Reports(zone.skill())))
        first = await outbox.news("", 0)
        outbox.publish(Announcement("htwg", "living", state, Occasion.STATUS))
        return first, await outbox.news(first.boot, first.version), await outbox.news("", 0)

    first, later, slow = ([one.topics for one in news.zones] for news in asyncio.run(told()))
    assert later == [("status",)]
    assert first == slow == [("forecast", "volatility", "gate", "skill", "status")], "who missed it is told all of it"

"""Which episodes there are, by which beliefs."""

from harness.closedloop.plan import BRAKE, CROSS, DARK, FREE, DriveRequest, plan_drives, with_truth


def request(**changes):
    return DriveRequest(**({"beliefs": "truth,mmpf,pmbm", "episodes": 5, "seed": 7} | changes))


def test_every_second_episode_is_provoked_and_each_pair_has_a_seed_of_its_own():
    grid = plan_drives(request())
    episodes = list(dict.fromkeys((run.config.seed, run.kind) for run in grid.runs))
    assert episodes == [(7, FREE), (7, BRAKE), (8, FREE), (8, BRAKE), (9, FREE)]


def test_provocations_take_turns_and_leave_what_is_free_as_it_is():
    both, usual = (plan_drives(request(provoke=kinds)).runs for kinds in ("cross,dark", "brake"))
    assert [run.kind for run in both if run.variant == "truth"] == [FREE, CROSS, FREE, DARK, FREE]
    assert [run.key for run in both if run.kind == FREE] == [run.key for run in usual if run.kind == FREE]


def test_every_belief_drives_every_episode():
    grid = plan_drives(request())
    assert len(grid.runs) == 5 * 3
    assert len({run.key for run in grid.runs}) == len(grid.runs)


def test_a_belief_with_a_label_is_called_by_it():
    runs = plan_drives(request(beliefs="calm=pmbm+lon_noise=1.5,truth,detections")).cells[0].runs
    assert [run.variant for run in runs[:3]] == ["calm", "truth", "detections"]
    assert runs[0].config.tracker.options == {"lon_noise": 1.5}


def test_a_belief_is_one_row_of_its_name_whatever_stands_in_for_its_tracker():
    rows = {run.variant: run.identity() for run in plan_drives(request()).cells[0].runs}
    assert [rows[name]["tracker"] for name in ("truth", "mmpf", "pmbm")] == [None, "mmpf", "pmbm"]
    assert all(row["model"] is None for row in rows.values())


def test_the_driver_is_part_of_what_a_drive_is_known_by():
    usual, other = (plan_drives(request(driver=driver)).runs[0].key for driver in (None, "idm"))
    assert usual != other


def test_heeding_the_unseen_is_part_of_it_too_and_never_doing_so_is_not():
    usual, heeding, never = (
        plan_drives(request(**more)).runs[0] for more in ({}, {"heed_unseen": 0.1}, {"heed_unseen": None})
    )
    assert heeding.heed_unseen == 0.1
    assert usual.key == never.key != heeding.key


def test_the_flow_is_drawn_by_seed_where_a_vehicle_is_to_stand_in_the_way_unless_it_is_asked_for():
    runs = plan_drives(request(provoke="stopped", episodes=40, density=None)).runs
    flows = {run.config.seed: run.flow_mps for run in runs}
    assert set(flows.values()) == {10.0, 15.0, 20.0, 25.0, 30.0}
    assert all(flows[run.config.seed] == run.flow_mps for run in runs)
    assert {run.config.traffic.density for run in runs} == {10.0}
    asked = plan_drives(request(provoke="stopped", flow=15.0, density=20.0)).runs
    assert {(run.flow_mps, run.config.traffic.density) for run in asked} == {(15.0, 20.0)}
    assert {run.flow_mps for run in plan_drives(request()).runs} == {None}


def test_how_often_a_dark_leader_is_detected_is_of_its_episodes_alone():
    usual, often = (plan_drives(request(provoke="dark", detected=each)).runs for each in (None, 0.6))
    assert {(run.kind, run.detected) for run in usual} == {("free", None), ("dark", 0.35)}
    assert {(run.kind, run.detected) for run in often} == {("free", None), ("dark", 0.6)}
    assert [a.key == b.key for a, b in zip(usual, often, strict=True)] == [run.kind == "free" for run in usual]


def test_flow_and_share_of_detections_leave_no_trace_where_they_are_not_asked_for():
    assert not {"flow", "detected"} & set(request().as_table())
    assert request(flow=15.0).as_table()["flow"] == 15.0


def test_the_truth_is_added_where_it_is_missing():
    assert with_truth(request(beliefs="mmpf")).beliefs == "truth,mmpf"
    assert with_truth(request(beliefs="mmpf,truth")).beliefs == "mmpf,truth"

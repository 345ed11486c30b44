"""Grow a tiny repertoire in this process, store it, and run one of its behaviors: python library.py FOLDER."""

import sys

from pga_me_ros import Search, Settings, make_task, save_run

settings = Settings(
    task="qd_hopper", algorithm="map_elites", batch_size=20, random_init=40, evaluations=100
)
task = make_task(settings.task)
search = Search(task.spec, settings)
for _ in range(settings.generations):
    print(f"QD-score {search.run_generation(task).qd_score:.0f}")
task.close()

run = save_run(sys.argv[1], search)
behavior = run.choose(descriptor=[0.4])  # the share of time that the foot touches the ground
episode = run.rollout(behavior, seed=1)
print(f"fitness {behavior.fitness:.1f} when found, {episode.fitness:.1f} from another pose")
print(run.save_gif(behavior, run.file.with_name("behavior.gif")))

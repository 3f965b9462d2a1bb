"""What the wing of shows adds: `demo`, `app`, and demonstrations of the main job."""

from myomorph.core.model.extension import CommandEntry, DemoEntry, Extension, SampleEntry

RECORDED = "myomorph.show.command:run_recorded"
PERFORMED = "myomorph.show.command:run_performed"
DEMO = "demo"  # The extra.
SOLVER = {"piqp": "piqp"}
MODEL = "myomorph.show.demo.demos:demo_model"

EXTENSION = Extension(
    commands={
        "demo": CommandEntry(
            function="myomorph.show.command:demo_command",
            help=("The main job on bundled data, from markers to a report."),
            example="myomorph demo --out demo",
            panel="Main job",
        ),
        "app": CommandEntry(
            function="myomorph.show.app.command:app_command",
            help="A local web page: drop recordings on it and read the results.",
            example="myomorph app",
            panel="Main job",
        ),
    },
    demos={
        "simulated": DemoEntry(
            run=RECORDED, help="a full-body squat with known truth", model=MODEL
        ),
        "jump": DemoEntry(
            run=RECORDED,
            help="a recorded countermovement jump with markers on one leg",
            model=MODEL,
            needs={"biomdp": "biomdp"},
            extra=DEMO,
        ),
        "judo": DemoEntry(
            run=PERFORMED,
            help="two simulated fighters, written as recordings with a study file",
            needs=SOLVER,
            extra=DEMO,
        ),
        "taichi": DemoEntry(
            run=PERFORMED,
            help="simulated Tai Chi on one plate, written as recordings with a study file",
            needs=SOLVER,
            extra=DEMO,
        ),
        "tap": DemoEntry(
            run=PERFORMED,
            help="simulated tap dance, written as recordings with a study file",
            needs=SOLVER,
            extra=DEMO,
        ),
        "drum": DemoEntry(
            run=PERFORMED,
            help="a simulated drum with microphones, written as recordings with a study file",
            needs=SOLVER,
            extra=DEMO,
        ),
    },
    pictures={"Model": "myomorph.lab.study.trial.notebook_pictures:model_picture"},
    samples={
        "walk": SampleEntry(make="myomorph.show.samples:walk", repeats=True),
        "run": SampleEntry(make="myomorph.show.samples:run", repeats=True),
        "squat": SampleEntry(make="myomorph.show.samples:squat"),
        "jump": SampleEntry(
            make="myomorph.show.samples:jump", needs={"biomdp": "biomdp"}, extra=DEMO
        ),
        "mouse": SampleEntry(make="myomorph.show.samples:mouse", repeats=True),
    },
)

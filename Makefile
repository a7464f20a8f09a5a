# Two commands do everything on a fresh Debian 12 or Ubuntu 24.04: make demo, make test.
.PHONY: demo test proof benchmark pictures garments format setup clean

bin := .venv/bin

demo: setup
	$(bin)/weft run configs/examples/knit_swatch.toml

test: setup
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/mypy
	$(bin)/lint-imports
	$(bin)/python -m pytest $(PYTEST_ARGUMENTS)

# Millions of samples and hundreds of kills: minutes to hours. Figures go into the README of their folder.
proof: setup
	$(bin)/python -m pytest -m proof $(PYTEST_ARGUMENTS)

# Ratios against peers, from one run; never pass or fail.
benchmark: setup
	$(bin)/python -m pytest tests/benchmarks -m benchmark -s

# The pictures of the README: the jobs with more samples than they ask for, half an hour on two cores.
# The stockinette needs the real inputs in ../shared/data.
pictures: setup
	set -e; for job in configs/examples/knit_swatch configs/examples/knit_closeup \
	                   tests/jobs/stockinette_tile tests/jobs/stockinette_closeup; do \
	    $(bin)/weft run $$job.toml --set render.samples_per_pixel=96; \
	    cp $$job.out/image.png pictures/$$(basename $$job).png; \
	done

# Scarf, fly-aways and close-ups, each with the samples its job asks for; about 15 minutes on two cores.
garments: setup
	set -e; for job in scarf scarf_closeup flyaways_without flyaways_with; do \
	    $(bin)/weft run configs/examples/$$job.toml; \
	    cp configs/examples/$$job.out/image.png pictures/$$job.png; \
	done

format: setup
	$(bin)/ruff check --fix .
	$(bin)/ruff format .

setup:
	@./setup.sh

clean:
	rm -rf .venv build .mypy_cache .ruff_cache .pytest_cache

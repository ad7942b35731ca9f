# The main job in a container: docker build -t slam-testbed . && docker run --rm -v "$PWD/runs:/work/runs" slam-testbed
FROM python:3.11-slim

WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY slam slam
COPY eval eval
COPY worlds worlds
COPY testbed testbed
RUN pip install --no-cache-dir .

# Compiled while the image is built, where every user of the image can read it.
ENV TESTBED_CACHE=/opt/slam-testbed
RUN testbed warmup && chmod -R a+rX /opt/slam-testbed

WORKDIR /work
ENTRYPOINT ["testbed"]
CMD ["run", "office"]

-- Body source and summary for wrk: posts the lines of $BODIES to the path, in turn; with $RATE (requests a second over all
-- connections) it waits between requests, at random about the mean, so that the rate is offered and not pulled.
local bodies, path, kind, mean_ms = {}, os.getenv("LOAD_PATH"), os.getenv("KIND") or "application/json", nil
local at, threads = 0, 0

for line in io.lines(os.getenv("BODIES")) do bodies[#bodies + 1] = line end
local chunk = tonumber(os.getenv("CHUNK") or "1")
local method = os.getenv("METHOD") or "POST"
local token = os.getenv("TOKEN")
if os.getenv("RATE") then mean_ms = 1000 * tonumber(os.getenv("CONNECTIONS")) / tonumber(os.getenv("RATE")) end

function setup(thread) thread:set("seed", threads) threads = threads + 1 end

function init() math.randomseed(1 + (seed or 0)) at = (seed or 0) * 7919 end

function request()
   local headers = { ["content-type"] = kind }
   if token then headers["authorization"] = "Bearer " .. token end
   if method == "GET" then return wrk.format("GET", path, headers) end
   local lines = {}
   for i = 1, chunk do
      at = at % #bodies + 1
      lines[i] = bodies[at]
   end
   return wrk.format("POST", path, headers, table.concat(lines, "\n"))
end

if mean_ms then
   function delay() return math.floor(-mean_ms * math.log(1 - math.random()) + 0.5) end
end

function done(summary, latency)
   local seconds, errors = summary.duration / 1e6, summary.errors
   local failed = errors.connect + errors.read + errors.write + errors.timeout + errors.status
   print(string.format("offered %s/s  achieved %.0f/s (%.0f logs/s)  p50 %.2f  p95 %.2f  p99 %.2f  max %.2f ms  errors %d",
      os.getenv("RATE") or "all it takes", summary.requests / seconds, summary.requests * chunk / seconds,
      latency:percentile(50) / 1000, latency:percentile(95) / 1000, latency:percentile(99) / 1000, latency.max / 1000, failed))
end

#include "check.hpp"
#include "nacre/errors.hpp"
#include "nacre/executor.hpp"

using namespace nacre;

int main() {
    for (int threads : {1, 2, 5}) {
        Executor executor(threads);
        CHECK(executor.threads() == threads);
        for (int round = 0; round < 200; ++round) {
            std::vector<int> hits(static_cast<std::size_t>(round), 0);
            executor.parallel_for(round, [&](Index task, int worker) {
                CHECK(worker >= 0 && worker < threads);
                ++hits[static_cast<std::size_t>(task)];
            });
            for (int hit : hits) CHECK(hit == 1);
        }
        // An exception of any task comes out, and the workers are ready for the next loop.
        CHECK(message_of([&] {
                  executor.parallel_for(1000, [](Index task, int) {
                      if (task == 17) throw std::runtime_error("task 17");
                  });
              }) == "task 17");
    }
    // Progress never goes back, ends at the end of the stage, and comes from the calling thread.
    std::vector<double> seen;
    const auto caller = std::this_thread::get_id();
    Executor executor(2, [&](double fraction, const std::string& message) {
        CHECK(std::this_thread::get_id() == caller && message == "half");
        seen.push_back(fraction);
        return true;
    });
    executor.stage(0, 0.5, "half");
    const auto nap = [](Index, int) { std::this_thread::sleep_for(std::chrono::milliseconds(20)); };
    executor.parallel_for(20, nap, true);
    executor.poll(true);
    for (std::size_t i = 1; i < seen.size(); ++i) CHECK(seen[i] >= seen[i - 1]);
    CHECK(seen.size() >= 3 && seen.back() > 0.4 && seen.back() <= 0.5);

    int calls = 0;
    Executor stopped(2, [&](double, const std::string&) { return ++calls < 3; });
    bool cancelled = false;
    try {
        stopped.parallel_for(1000, nap);
    } catch (const Cancelled&) {
        cancelled = true;
    }
    CHECK(cancelled);
    CHECK(!message_of([] { Executor(-1); }).empty());
    std::puts("ok");
}

// Worker threads, progress and cancelling for one long call.
//
// Work is cut into tasks whose number and size depend on the data alone, never on the number of
// threads, and each task writes its own part of the result; sums over tasks are taken in task
// order. So a result has the same bits for any number of threads.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "nacre/tensor.hpp"

namespace nacre {

class Executor {
  public:
    // fraction in [0, 1] of the whole call; returns false to ask for a stop.
    using Progress = std::function<bool(double fraction, const std::string& message)>;

    // threads = 0: as many as the process may run at once.
    explicit Executor(int threads = 0, Progress progress = {});
    ~Executor();
    Executor(const Executor&) = delete;
    Executor& operator=(const Executor&) = delete;

    int threads() const { return static_cast<int>(workers_.size()) + 1; }

    // Following loops are reported as `message`, between `begin` and `end` of the whole call.
    void stage(double begin, double end, std::string message);

    // Calls the progress callback if it was not called lately. Throws Cancelled if it says stop,
    // and lets through what it throws. Only the thread that runs the call may do this.
    void poll(bool force = false);

    // body(task, worker) for every task in [0, tasks); worker < threads() is for scratch memory.
    // The calling thread works too and polls between its tasks. The first exception is rethrown.
    // With `advance`, the finished part of the tasks moves the reported fraction through the stage.
    template <class Body>
    void parallel_for(Index tasks, Body&& body, bool advance = false) {
        run(
            tasks,
            [](void* context, Index task, int worker) {
                (*static_cast<std::remove_reference_t<Body>*>(context))(task, worker);
            },
            const_cast<void*>(static_cast<const void*>(&body)), advance);
    }

  private:
    using Invoke = void (*)(void* context, Index task, int worker);
    struct Job;

    void run(Index tasks, Invoke invoke, void* context, bool advance);
    void work(int worker);
    static void take_tasks(Job& job, int worker);

    Progress progress_;
    double begin_ = 0, end_ = 1, fraction_ = 0;
    std::string message_;
    std::chrono::steady_clock::time_point last_poll_;

    std::vector<std::thread> workers_;
    std::mutex mutex_;
    std::condition_variable wake_, idle_;
    std::atomic<std::uint64_t> generation_{0};
    Job* job_ = nullptr;
    int active_ = 0;
    bool quit_ = false;
};

}  // namespace nacre

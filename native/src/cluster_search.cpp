#include "nacre/cluster_search.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "nacre/blas.hpp"

namespace nacre {

namespace {

using Set = std::vector<ClusterId>;  // ascending

// Items by the set that is asked about. Ordered, so that the work is the same in every run.
using Queries = std::map<Set, std::vector<Index>>;

constexpr Index kChunk = 256;  // items in one task

Set sorted_with(const Set& set, ClusterId further) {
    Set result = set;
    result.insert(std::upper_bound(result.begin(), result.end(), further), further);
    return result;
}

MatrixD gram_of(const ReducedItems& items, const Set& set) {
    const Index count = static_cast<Index>(set.size()), rank = items.rank;
    MatrixD gram(count * rank, count * rank);
    for (Index i = 0; i < count; ++i) {
        for (Index j = 0; j < count; ++j) {
            gram.block(i * rank, j * rank, rank, rank) =
                items.gram.block(set[at(i)] * rank, set[at(j)] * rank, rank, rank);
        }
    }
    return gram;
}

// body(set, factor of its Gram matrix, projections of the rows of some items on it, those items).
template <class Body>
void solve(Executor& executor, const ReducedItems& items, const Queries& queries, Body&& body) {
    struct Task {
        const Set* set;
        std::span<const Index> items;
        std::size_t factor;
    };
    constexpr std::size_t kSets = 128;  // whose factors are held at a time
    const Index rank = items.rank, stride = items.clusters * rank;
    for (auto query = queries.begin(); query != queries.end();) {
        std::vector<const Set*> sets;
        std::vector<Task> tasks;
        for (; query != queries.end() && sets.size() < kSets; ++query) {
            const std::span<const Index> list(query->second);
            for (std::size_t first = 0; first < list.size(); first += kChunk) {
                const std::size_t count = std::min<std::size_t>(kChunk, list.size() - first);
                tasks.push_back({&query->first, list.subspan(first, count), sets.size()});
            }
            sets.push_back(&query->first);
        }
        std::vector<MatrixD> factors(sets.size());
        executor.parallel_for(static_cast<Index>(sets.size()), [&](Index number, int) {
            factors[at(number)] = inverse_factor(gram_of(items, *sets[at(number)]));
        });
        executor.parallel_for(static_cast<Index>(tasks.size()), [&](Index number, int) {
            const Task& task = tasks[at(number)];
            const Index width = static_cast<Index>(task.set->size()) * rank;
            MatrixD rows(static_cast<Index>(task.items.size()) * items.tied, width);
            for (Index i = 0; i < rows.rows(); ++i) {
                const Index row = task.items[at(i / items.tied)] * items.tied + i % items.tied;
                for (std::size_t k = 0; k < task.set->size(); ++k) {
                    std::copy_n(items.projections + row * stride + (*task.set)[k] * rank, rank,
                                rows.data() + i * width + static_cast<Index>(k) * rank);
                }
            }
            body(*task.set, factors[task.factor], rows, task.items);
        });
    }
}

MatrixD multiply(const MatrixD& a, const MatrixD& b) {
    MatrixD c(a.rows(), b.cols());
    gemm(Op::kNone, Op::kNone, a.rows(), b.cols(), a.cols(), 1.0, a.data(), a.cols(), b.data(),
         b.cols(), 0.0, c.data(), c.cols());
    return c;
}

// Theorem 4 (Eq. 15), one row of coefficients for each row of projections.
MatrixD coefficients_of(const MatrixD& rows, const MatrixD& factor) {
    const MatrixD transposed = factor.transpose();
    return multiply(multiply(rows, factor), transposed);
}

// The best set so far of every item, ties to the one that comes first.
struct Best {
    explicit Best(Index items) : sets(at(items)), energies(at(items), -1) {}
    std::vector<Set> sets;
    std::vector<double> energies;
};

// Takes over each set that explains more energy of an item that asks about it, after optimal
// projection (MK-CTA, Eq. 15).
void keep_best(Executor& executor, const ReducedItems& items, const Queries& queries, Best& best) {
    std::map<Set, std::vector<double>> answers;
    for (const auto& [set, list] : queries) answers[set].resize(list.size());
    solve(executor, items, queries,
          [&](const Set& set, const MatrixD& factor, const MatrixD& rows, auto asked) {
              const MatrixD reduced = multiply(rows, factor);
              const std::vector<Index>& list = queries.at(set);
              const Index first = asked.data() - list.data();
              std::vector<double>& answer = answers.at(set);
              for (std::size_t i = 0; i < asked.size(); ++i) {
                  answer[at(first) + i] =
                      reduced.middleRows(static_cast<Index>(i) * items.tied, items.tied)
                          .squaredNorm();
              }
          });
    for (const auto& [set, list] : queries) {
        const std::vector<double>& answer = answers.at(set);
        for (std::size_t i = 0; i < list.size(); ++i) {
            if (answer[i] <= best.energies[at(list[i])]) continue;
            best.energies[at(list[i])] = answer[i];
            best.sets[at(list[i])] = set;
        }
    }
}

// K-CTA's greedy search: the first mixture cluster by Theorem 1 (Eq. 9), each further one by
// Theorem 3 (Eq. 13) for the residual that optimal projection (Theorem 4, Eq. 15) leaves.
std::vector<Set> kcta_search(Executor& executor, const ReducedItems& items, Index mixtures) {
    const Index rank = items.rank, tied = items.tied, width = items.clusters * rank;
    std::vector<MatrixD> dual(at(items.clusters));  // S_c^(-1/2) of each, up to a rotation
    for (Index c = 0; c < items.clusters; ++c) {
        dual[at(c)] = inverse_factor(gram_of(items, {static_cast<ClusterId>(c)}));
    }
    std::vector<Set> chosen(at(items.items()));
    MatrixD residuals = Eigen::Map<const MatrixD>(items.projections, items.rows, width);
    for (Index k = 0; k < mixtures; ++k) {
        const Index tasks = (items.items() + kChunk - 1) / kChunk;
        executor.parallel_for(tasks, [&](Index task, int) {
            for (Index i = task * kChunk; i < std::min(items.items(), (task + 1) * kChunk); ++i) {
                const auto rows = residuals.middleRows(i * tied, tied);
                double most = -1;
                ClusterId best = 0;
                for (Index c = 0; c < items.clusters; ++c) {
                    const ClusterId id = static_cast<ClusterId>(c);
                    if (std::find(chosen[at(i)].begin(), chosen[at(i)].end(), id) !=
                        chosen[at(i)].end()) {
                        continue;
                    }
                    const double norm =
                        (rows.middleCols(c * rank, rank) * dual[at(c)]).squaredNorm();
                    if (norm > most) {
                        most = norm;
                        best = id;
                    }
                }
                chosen[at(i)] = sorted_with(chosen[at(i)], best);
            }
        });
        if (k + 1 == mixtures) break;
        Queries queries;
        for (Index i = 0; i < items.items(); ++i) queries[chosen[at(i)]].push_back(i);
        solve(executor, items, queries,
              [&](const Set& set, const MatrixD& factor, const MatrixD& rows, auto asked) {
                  const MatrixD coefficients = coefficients_of(rows, factor);
                  MatrixD taken(rows.cols(), width);
                  for (std::size_t j = 0; j < set.size(); ++j) {
                      taken.middleRows(static_cast<Index>(j) * rank, rank) =
                          items.gram.middleRows(set[j] * rank, rank);
                  }
                  const MatrixD less = multiply(coefficients, taken);
                  for (std::size_t i = 0; i < asked.size(); ++i) {
                      residuals.middleRows(asked[i] * tied, tied) =
                          Eigen::Map<const MatrixD>(items.projections + asked[i] * tied * width,
                                                    tied, width) -
                          less.middleRows(static_cast<Index>(i) * tied, tied);
                  }
              });
    }
    return chosen;
}

// MK-CTA, Algorithm 3.
std::vector<Set> greedy_search(Executor& executor, const ReducedItems& items, Index mixtures) {
    Best best(items.items());
    for (Index k = 0; k < mixtures; ++k) {
        Queries queries;
        for (Index i = 0; i < items.items(); ++i) {
            const Set& set = best.sets[at(i)];
            for (ClusterId c = 0; c < static_cast<ClusterId>(items.clusters); ++c) {
                if (std::binary_search(set.begin(), set.end(), c)) continue;
                queries[sorted_with(set, c)].push_back(i);
            }
        }
        // A cluster that adds nothing (less, by rounding) must still be added.
        std::fill(best.energies.begin(), best.energies.end(), -1);
        keep_best(executor, items, queries, best);
    }
    return std::move(best.sets);
}

// MK-CTA, Algorithm 2.
std::vector<Set> optimal_search(Executor& executor, const ReducedItems& items, Index mixtures) {
    std::vector<Index> all(at(items.items()));
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<Index>(i);
    Best best(items.items());
    Set set(at(mixtures));
    for (std::size_t k = 0; k < set.size(); ++k) set[k] = static_cast<ClusterId>(k);
    constexpr std::size_t kSets = 64;  // in one round
    for (bool more = true; more;) {
        Queries queries;
        while (more && queries.size() < kSets) {
            queries[set] = all;
            std::size_t k = set.size();  // the next combination in order
            while (k > 0 &&
                   set[k - 1] == static_cast<ClusterId>(items.clusters) - (set.size() - k) - 1) {
                --k;
            }
            more = k > 0;
            if (!more) break;
            ++set[k - 1];
            for (std::size_t j = k; j < set.size(); ++j) set[j] = set[j - 1] + 1;
        }
        keep_best(executor, items, queries, best);
        executor.poll();
    }
    return std::move(best.sets);
}

}  // namespace

MatrixD inverse_factor(const MatrixD& gram) {
    // Functions without energy take no part.
    std::vector<Index> used;
    for (Index i = 0; i < gram.rows(); ++i) {
        if (gram(i, i) > 0) used.push_back(i);
    }
    const Index n = static_cast<Index>(used.size());
    if (n == 0) return MatrixD(gram.rows(), 0);
    VectorD scale(n);
    MatrixD correlation(n, n);
    for (Index i = 0; i < n; ++i) scale(i) = 1 / std::sqrt(gram(used[at(i)], used[at(i)]));
    for (Index i = 0; i < n; ++i) {
        for (Index j = 0; j < n; ++j) {
            correlation(i, j) = gram(used[at(i)], used[at(j)]) * scale(i) * scale(j);
        }
    }
    MatrixD inverse;  // n x rank
    const Eigen::LLT<MatrixD> cholesky(correlation);
    // A pivot is the squared sine of the angle to the functions before it.
    if (cholesky.info() == Eigen::Success &&
        cholesky.matrixLLT().diagonal().array().square().minCoeff() > kDependent) {
        inverse = MatrixD::Identity(n, n);
        cholesky.matrixU().solveInPlace(inverse);
    } else {
        const Eigen::SelfAdjointEigenSolver<MatrixD> solver(correlation);
        const auto& values = solver.eigenvalues();  // ascending
        Index first = 0;
        while (first < n && values(first) <= kDependent * values(n - 1)) ++first;
        inverse.resize(n, n - first);
        for (Index k = first; k < n; ++k) {
            inverse.col(k - first) = solver.eigenvectors().col(k) / std::sqrt(values(k));
        }
    }
    MatrixD factor = MatrixD::Zero(gram.rows(), inverse.cols());
    for (Index i = 0; i < n; ++i) factor.row(used[at(i)]) = scale(i) * inverse.row(i);
    return factor;
}

Membership search_clusters(Executor& executor, const ReducedItems& items, Index mixtures,
                           SearchMethod method, std::span<const ClusterId> candidates, Index sets) {
    std::vector<Set> chosen;
    switch (method) {
        case SearchMethod::kKcta:
            chosen = kcta_search(executor, items, mixtures);
            break;
        case SearchMethod::kGreedy:
            chosen = greedy_search(executor, items, mixtures);
            break;
        default:
            chosen = optimal_search(executor, items, mixtures);
    }
    if (sets > 0) {
        Best best(items.items());
        const auto ask = [&](auto&& set_of) {
            Queries queries;
            for (Index i = 0; i < items.items(); ++i) queries[set_of(i)].push_back(i);
            keep_best(executor, items, queries, best);
        };
        ask([&](Index i) { return chosen[at(i)]; });
        for (Index s = 0; s < sets; ++s) {
            ask([&](Index i) {
                const auto given = candidates.subspan(at((i * sets + s) * mixtures), at(mixtures));
                Set set(given.begin(), given.end());
                std::sort(set.begin(), set.end());
                return set;
            });
        }
        chosen = std::move(best.sets);
    }
    Membership result;
    const Index rank = items.rank;
    result.clusters.reserve(at(items.items() * mixtures));
    result.coefficients.resize(at(items.rows * mixtures * rank));
    Queries queries;
    for (Index i = 0; i < items.items(); ++i) {
        queries[chosen[at(i)]].push_back(i);
        result.clusters.insert(result.clusters.end(), chosen[at(i)].begin(), chosen[at(i)].end());
    }
    solve(executor, items, queries,
          [&](const Set&, const MatrixD& factor, const MatrixD& rows, auto asked) {
              const MatrixD coefficients = coefficients_of(rows, factor);
              for (std::size_t i = 0; i < asked.size(); ++i) {
                  std::copy_n(
                      coefficients.data() + static_cast<Index>(i) * items.tied * mixtures * rank,
                      items.tied * mixtures * rank,
                      result.coefficients.data() + asked[i] * items.tied * mixtures * rank);
              }
          });
    return result;
}

}  // namespace nacre

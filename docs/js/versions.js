// Fills the selector of versions. versions.js, beside the folders of all versions, names them and their pages. It is a
// script and no JSON, because pages from disk may not read files.
(() => {
    const root = new URL("../../", document.currentScript.src)
    const list = document.createElement("script")
    list.src = new URL("versions.js", root)
    list.onload = () => {
        const [, page] = location.pathname.slice(root.pathname.length).match(/^[^/]+\/(.*)$/) ?? [, ""]
        const items = Object.entries(vdfmuVersions).map(([name, pages]) => {
            const link = document.createElement("a")
            link.className = "md-version__link"
            link.href = new URL(`${name}/${pages.includes(page) ? page : "index.html"}`, root)
            link.textContent = name
            const item = document.createElement("li")
            item.className = "md-version__item"
            item.append(link)
            return item
        })
        const selector = document.createElement("ul")
        selector.className = "md-version__list"
        selector.append(...items)
        document.querySelector(".md-version").append(selector)
    }
    document.head.append(list)
})()
